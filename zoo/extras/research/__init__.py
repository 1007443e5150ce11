"""What researchers need: failing roads, policies that doubt, an official test, papers."""
