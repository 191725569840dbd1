"""Decision makers against the aware observer: least information, and largest error."""
