"""Emulation without hardware: the launcher's firmware, faults on request, and a table with hidden constants."""
