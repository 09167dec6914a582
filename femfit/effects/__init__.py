"""Physical effects that a model may lack, in files by what they act on; :mod:`femfit.effects.catalogue` lists them."""
