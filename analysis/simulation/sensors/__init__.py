"""What sensors report of a motion, and what the recorder keeps."""
