"""Messages to columns: many stored messages at once, without an object for any of them.

A definition is compiled once into a program (`program`, `located`). Over a batch of messages
`walk` runs it and notes where things lie, and `columns` gathers values from there, a column at a
time. A type that no program can express goes through rosbags, message by message (`fallback`).
"""
