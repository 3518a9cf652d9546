"""Reading, reporting and comparing what runs left."""
