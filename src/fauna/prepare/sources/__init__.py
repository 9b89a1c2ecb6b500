"""What a pile of photographs may look like, and how it becomes rows."""
