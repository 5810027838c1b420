"""Converted logs: a folder of Parquet by topic, and the description that makes it a log again."""
