"""Methods for those who compare, one file each."""
