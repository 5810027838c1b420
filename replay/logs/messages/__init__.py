"""What decoding and reading share: types of messages, their fields, raw batches, broken bytes."""
