"""Effects of a laboratory's machines; nothing here is executed."""
