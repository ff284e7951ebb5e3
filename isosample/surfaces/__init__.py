"""One triangle mesh per isovalue and brick: where it is."""
