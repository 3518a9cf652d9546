"""What waves the interface of a case carries, measured on strips of its own crystal."""
