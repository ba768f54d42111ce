"""Built-in furniture: parametric meshes of our own, made to the size that is asked for (docs/guides/furniture.md)."""
