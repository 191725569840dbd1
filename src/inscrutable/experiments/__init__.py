"""Step 7: many decisions in a row, and their outcome."""
