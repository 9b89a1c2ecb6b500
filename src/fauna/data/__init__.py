"""See docs/architecture.md for where this package sits in the data flow."""
