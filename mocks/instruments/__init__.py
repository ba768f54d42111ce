"""Simulated instruments: cameras and a meter that speak their protocols, with faults on request."""
