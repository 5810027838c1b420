"""Words, numbers, colours and pages that more than one feature uses."""
