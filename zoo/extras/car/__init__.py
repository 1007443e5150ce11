"""How fast a network drives on a computer with measured loop times."""
