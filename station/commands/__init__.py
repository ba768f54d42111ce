"""The commands of `daylit`, one module each; imported only when used."""
