rule estimate:
    # The constants with their standard errors, from the last round and the sensitivities it asked for.
    input:
        rounds_and_solutions,
        last=last_round,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
        mesh=f"{MODEL}/mesh.inp",
    output:
        estimate=f"{MODEL}/estimate.json",
        table=f"{MODEL}/table.txt",
    log:
        f"{MODEL}/logs/estimate.log",
    params:
        settings=SETTINGS.part("estimate"),
        code=package_fingerprint("estimate"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit estimate {input.settings} --data {input.data} --mesh {input.mesh} --last {input.last}"
        " --out {output.estimate} --table {output.table} 2> {log}"


rule plot:
    # The figures: deformed mesh, pictures, force against displacement, course of the search.
    input:
        settings=ancient(SETTINGS_FILE),
        estimate=f"{MODEL}/estimate.json",
        data=f"{MODEL}/prepared.npz",
        mesh=f"{MODEL}/mesh.inp",
        last=last_round,
    output:
        f"{MODEL}/figures/pictures.png",
    log:
        f"{MODEL}/logs/plot.log",
    params:
        code=package_fingerprint("plot"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit plot {input.settings} --data {input.data} --mesh {input.mesh} --last {input.last}"
        " --estimate {input.estimate} --out {output} 2> {log}"
