"""Data sets of simulated sessions; beside `station.rig` the only place here that knows the mocks."""
