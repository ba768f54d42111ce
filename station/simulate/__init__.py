"""Data sets of simulated sessions; beside `station.capture.rig` the only place here that knows the mocks."""
