"""The hidden-effect trial: campaigns with a truth of other physics than the effects', and how the diagnosis does."""
