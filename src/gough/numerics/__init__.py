"""Generic numerical loops; they know nothing of robots."""
