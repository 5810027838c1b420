"""Decode messages to columns: many messages at once, without a Python object for any of them.

A definition is compiled once into a program (`decode_program`). `walk_program` runs the program
over a batch of messages and marks where each field is. Fields at fixed offsets are gathered while
their bytes are in the processor's cache (`direct_fields`, `one_pass`), all others by these marks, a
column at a time (`field_columns`). A type that no program can express is decoded by a library,
message by message (`decoder_choice`).
"""
