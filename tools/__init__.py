"""Programs that write files of this repository; they run at development time only."""
