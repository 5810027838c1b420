"""Texts, number formats, colours and pages shared by several features."""
