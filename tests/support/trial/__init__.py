"""A bench of other physics than the catalogue's, for the diagnosis to be judged on; the benchmarks run it.

Truths of three disjoint sets by :mod:`support.trial.sets`, records over time by :mod:`support.trial.records`.
"""
