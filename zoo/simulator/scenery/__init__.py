"""The look of a world: meshes of road, ground and plants, textures, light and air."""
