"""Light: the scene, one solver, pictures of staged rooms, relighting."""
