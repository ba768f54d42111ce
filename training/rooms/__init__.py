"""Rooms drawn for training: plans, surfaces, furniture, light and the pictures of them."""
