"""Linear methods: the spectral decomposition, priors, and the rules that choose a parameter."""
