"""What is hidden in a trial beside the usual errors: truths of three disjoint sets, each by its own physics."""
