"""An audit of two files: what decisions tell of a secret to one who learns from data alone, without any model."""
