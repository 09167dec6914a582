"""What each effect would add to the readings."""
