"""How the shipped networks are made: data from simulated rooms, training, export. Not part of the program."""
