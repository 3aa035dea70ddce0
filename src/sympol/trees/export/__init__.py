"""One file a language or format."""
