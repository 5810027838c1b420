"""Messages to columns: many stored messages at once, without an object for any of them.

A definition is compiled once into a program (`program`, `located`). Over a batch of messages
`walk` runs it and notes where things lie. What every message has is gathered while its bytes are at
hand (`direct`, `one_pass`), all else from what was noted, a column at a time (`columns`). A type
that no program can express goes through a library, message by message (`fallback`).
"""
