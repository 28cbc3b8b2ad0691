"""Methods for comparison with published algorithms, one file each."""
