"""Commands about filters: list them, write one, check one."""
