"""What people learn about a recording before they train on it."""
