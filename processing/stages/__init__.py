"""The stages of processing: thin shells that read inputs, call the numeric modules, and write results."""
