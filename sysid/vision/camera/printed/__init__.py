"""Printed markers on the cushions: their sheet, where a picture shows them, and the camera that they give."""
