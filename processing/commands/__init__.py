"""Commands of the offline side; each module is imported only when its command is used."""
