"""The command `follow`: read and weigh a log while it is being recorded."""
