"""method="rectified": contact as the positive part of a Gaussian process; offsets, broken readings and discrepancy are terms of the same model."""
