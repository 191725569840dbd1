"""Decision makers that survive an observer who knows them: least information, and largest error."""
