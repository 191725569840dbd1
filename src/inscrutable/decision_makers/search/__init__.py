"""The search for the most private decisions: faces, climbs, many beliefs at once."""
