"""The joint fit's numerics: priors, group effects, and the partition into load states."""
