"""Linear methods: the spectrum, priors, and every rule that chooses a parameter."""
