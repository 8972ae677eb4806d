"""What recordings tell of a sensor."""
