"""Two replays in one recording, and what differs in words."""
