"""Physical effects that a model may lack: one small file each, registered in :mod:`femfit.effects.catalogue`."""
