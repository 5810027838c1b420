"""The paper found anew, as files: a Markdown page or CSV files, and a picture a figure.

`items` is the table of all there is; `page` writes what was found.
"""
