"""A fleet's results over machines and days: tables, control charts, what needs a look."""
