"""Simulated instruments and the world they look at; they share only code tables with the drivers."""
