"""Tables as devices and programs write them, all of one drive."""
