"""The Canon EOS 5D Mark II over PTP."""
