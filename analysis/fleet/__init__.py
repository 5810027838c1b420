"""Results of a fleet over machines and days: tables, control charts, recordings to review."""
