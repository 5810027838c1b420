"""The estimators, one file each; the contract test runs on all of them."""
