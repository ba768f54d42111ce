"""Pictures of a lit scene: staged panoramas and other viewpoints."""
