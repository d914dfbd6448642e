rule prepare:
    # Reads and checks the study, smooths and scales the pictures, makes the mesh.
    input:
        settings=ancient(SETTINGS_FILE),
        study=layout.study_files(SETTINGS),
    output:
        data=f"{MODEL}/prepared.npz",
        **MESHES,
    log:
        f"{MODEL}/logs/prepare.log",
    params:
        settings=PARTS["prepare"],
        code=layout.fingerprint("prepare"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit prepare {input.settings} --out {output.data} {MESH_OPTIONS} 2> {log}"
