"""The Ricoh Theta Z1 over PTP."""
