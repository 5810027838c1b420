"""Pages that a person reads: one file each, with what reviews and fleets have alike."""
