"""Many runs that belong together, one table: trained and evaluated one after the other, wherever it was interrupted."""
