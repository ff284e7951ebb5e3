"""Regular grids of scalars: what is sampled."""
