"""Procedural rooms whose geometry, materials and light are known: the measuring stick of everything after it."""
