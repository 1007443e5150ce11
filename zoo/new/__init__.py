"""Write the files of a part of the user's own from templates."""
