"""How many floating-point operations a law takes, counted by a number that is put through it."""


class Counting:
    """A number that counts the floating-point operations done with it."""

    def __init__(self, counter):
        self.counter = counter

    def _one(self, *_):
        self.counter[0] += 1
        return Counting(self.counter)

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = sqrt = _one

    def exp(self):
        self.counter[0] += 20
        return Counting(self.counter)

    log = exp
