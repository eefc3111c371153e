"""The launcher and its table without hardware: firmware, faults on request, and a table with hidden constants."""
