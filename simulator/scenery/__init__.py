"""What a world looks like: meshes of road, ground and plants, their textures, and the air."""
