from tselab.cli import main

main()
