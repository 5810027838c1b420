"""Containers: one file a format, over bytes that are bounded, unpacked and checked in one place."""
