"""Writers of simulated logs: a function per format, and a shared serialiser of messages."""
