"""The Donkeycar simulator both ways, and the dialects of forks of the original simulator."""
