"""Reading and writing of descriptions as text."""
