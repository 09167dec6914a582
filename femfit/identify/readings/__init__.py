"""What was measured beside what the model predicts."""
