"""Numbers that users get by the public door, frozen: see renew.py."""
