"""The commands on a recording: `show`, `plot`, `view`, and the viewer's importer."""
