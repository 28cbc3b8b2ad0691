"""Methods that know contact: friction cone, noise, posterior, ensemble, sliding."""
