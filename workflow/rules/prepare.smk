rule prepare:
    # Reads and checks the study, smooths and scales the pictures, makes the mesh.
    input:
        settings=ancient(SETTINGS_FILE),
        study=SETTINGS.study_files,
    output:
        data=f"{MODEL}/prepared.npz",
        mesh=f"{MODEL}/mesh.inp",
    log:
        f"{MODEL}/logs/prepare.log",
    params:
        settings=SETTINGS.part("prepare"),
        code=package_fingerprint("prepare"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit prepare {input.settings} --out {output.data} --mesh {output.mesh} 2> {log}"
