"""From channels as read to one uniform grid."""
