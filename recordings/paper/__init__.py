"""Reproduction of the paper as files: a Markdown page or CSV files, and pictures of its figures.

`paper_items` lists all items; `paper_page` writes the results.
"""
