"""Messages to columns: many stored messages at once, without an object for any of them.

A definition is compiled once into a program (`decode_program`). `walk_program` runs the program
over a batch of messages and notes where each field lies. Fields that every message has are gathered
while their bytes are at hand (`direct_fields`, `one_pass`), all others from those notes, a column
at a time (`field_columns`). A type that no program can express is decoded by a library, message by
message (`decoder_choice`).
"""
