"""Step 7: many decisions in a row, and what comes of them."""
