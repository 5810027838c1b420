"""Reproduction of the paper as files: a Markdown page or CSV files, and pictures of figures.

`items` lists all items; `page` writes the results.
"""
