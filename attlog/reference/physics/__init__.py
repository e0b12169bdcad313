"""What physics says of sensors and references before anybody is compared with them."""
