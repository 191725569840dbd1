"""The search for the most private decisions: faces, climbs, walks over many beliefs."""
