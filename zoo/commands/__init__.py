"""The commands: one file each, with a typed function; no command imports another."""
