"""Is everything ready for the joint to be armed? Looks, and never sends: `eampc check`."""
