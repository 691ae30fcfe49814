"""The law engine beside its peers, on the same problems and points, in one run: `eampc bench`."""
