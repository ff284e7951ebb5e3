"""isosample: volume rendering that samples where the data changes."""
