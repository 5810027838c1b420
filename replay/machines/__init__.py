"""Machine files, including those that payscope ships."""
