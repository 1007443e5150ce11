"""A network on the car's computer: files in C, of 8 bits and for Donkeycar; loop times."""
